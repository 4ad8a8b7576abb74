"""Published results, each figure a scenario."""
