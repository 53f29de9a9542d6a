"""Many random brakings: what is drawn, how it is distributed, what is judged."""
