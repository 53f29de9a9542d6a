"""Commands about this workspace and about the command line itself."""
