"""Loops and controllers that run at sampling instants t_k = k dt."""
