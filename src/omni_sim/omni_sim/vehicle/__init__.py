"""The body on its wheels: configuration, loads, Newton's equations, uneven ground."""
