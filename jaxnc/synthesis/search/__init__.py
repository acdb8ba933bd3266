"""Searches: random designs, refined, brought to their ends, told apart and ranked."""
