"""Where to look next: the map of what is known, the worth of a view, the best view, and the loop around them."""
