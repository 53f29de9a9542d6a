"""What the studies of section 3.6 share."""
