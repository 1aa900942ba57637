"""Golden runs: hashes of the package's results, compared with committed ones."""
