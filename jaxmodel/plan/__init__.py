"""Next best view planning (thesis ch. 4): label map, exact march, utility, search and closed loop, and the arm."""
