"""``jaxmodel mesh``: a cloud, or several posed ones, made a mesh with its measures, segments and report."""
