"""The ground under the wheels: friction and height."""
