"""Error models of sources of the body twist."""
