"""``jaxmodel plan`` and the experiments of chapter 4: next best views with the virtual scanner."""
