"""The exit codes of the command line."""

EXIT_OK = 0
EXIT_FAILED = 1
EXIT_REFUSED = 2  # before anything started
EXIT_INTERRUPTED = 130  # by Ctrl-C
EXIT_TERMINATED = 143  # by SIGTERM
