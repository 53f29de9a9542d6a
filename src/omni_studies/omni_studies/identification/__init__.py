"""Which vehicle gives Table 2, and how much each number depends on it."""
