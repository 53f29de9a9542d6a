"""Interface of tire models, and a solver of the contact equation that suits every model."""
