"""Where to look next: the label map, the utility of a view, the view space, and the arm that carries the sensor."""
