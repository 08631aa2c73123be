"""Sensor models: noise, mounting, gate and prediction, one sensor a module."""
