"""How short a stop can be at best: certified bounds from forces, loads and friction alone."""
