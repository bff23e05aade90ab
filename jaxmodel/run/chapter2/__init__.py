"""The experiments of thesis chapter 2."""
