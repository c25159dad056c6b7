"""What compiled loops are built of."""
