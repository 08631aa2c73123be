"""Scanning sonar: from echo profiles to scans and maps."""
