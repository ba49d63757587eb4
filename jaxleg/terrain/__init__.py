"""Height maps, their generators, and where a foot may be placed."""
