"""Three published systems beside ours, over many seeds: ``python -m benchmarks.seeds``."""
