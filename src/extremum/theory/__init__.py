"""Theory: what the equations say before they are integrated."""
