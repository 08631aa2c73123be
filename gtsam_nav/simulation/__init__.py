"""Simulated missions: a world, a vehicle, its sensors and their faults."""
