"""Vehicle body on its wheels: configuration, loads, equations of motion, uneven ground."""
