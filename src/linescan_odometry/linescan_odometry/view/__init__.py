"""What a camera sees beside the moving ground: fixed patterns, covers, grain."""
