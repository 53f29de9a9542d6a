"""Control laws, which compute brake enables from a valid twist; one module each."""
