"""The cheapest solver and step that keep a tolerance, tried and verified."""
