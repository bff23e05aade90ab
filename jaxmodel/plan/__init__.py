"""Where to look next (thesis ch. 4): label map, exact march, utility, search and closed loop, and the arm."""
