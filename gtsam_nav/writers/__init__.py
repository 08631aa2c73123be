"""Trajectories, graphs, maps and mission folders on disk."""
