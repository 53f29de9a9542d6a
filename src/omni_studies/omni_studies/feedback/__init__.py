"""Error models of the sensors and estimators that supply the body twist."""
