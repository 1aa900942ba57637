"""What the two theses did, to compare with."""
