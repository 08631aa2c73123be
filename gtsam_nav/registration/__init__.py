"""Pairwise registration of point sets: stateless, one protocol, one result type."""
