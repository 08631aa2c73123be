"""Stateful odometry from 3-D clouds."""
