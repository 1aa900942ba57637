"""The SRG: proximity sensing, Algorithm 1, reference, servo and their wiring."""
