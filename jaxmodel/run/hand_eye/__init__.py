"""The experiments of RR-3507."""
