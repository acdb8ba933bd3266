"""The opponents: other ways to compute the same poses, timed in the same run."""
