"""One short script per question; each prints a table and writes runs/NAME/result.json."""
