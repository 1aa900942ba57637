"""Golden runs: hashes of what the package computes, compared with committed ones."""
