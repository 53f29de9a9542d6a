"""Control laws: which brakes help, given a twist that can be trusted. One module each."""
