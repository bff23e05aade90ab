"""Where to look next: label map, ray march, utility, viewpoints, exploration, arm (thesis ch. 4)."""
