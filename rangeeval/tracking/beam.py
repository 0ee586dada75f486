"""Alpha-beta in beam coordinates (stand-in)."""
