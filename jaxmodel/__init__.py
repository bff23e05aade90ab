"""Range images in, a registered and meshed object model out.

Folders are the data flow, in order: ``geometry`` (shared mathematics), ``scan`` (what a sensor gives),
``control_points`` (which points drive registration), ``lanes`` (one step function, thousands of items),
``register`` (align views), ``calibrate`` (hand-eye calibration); ``io`` holds files,
``run`` orchestration, ``view`` pictures.
"""

__version__ = "0.1.0"
