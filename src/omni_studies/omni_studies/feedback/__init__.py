"""Sources of the body twist that people own, as error models for the loop."""
