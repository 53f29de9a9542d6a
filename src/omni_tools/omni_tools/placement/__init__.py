"""Where line cameras measure the twist best."""
