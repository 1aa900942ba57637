"""One arm hands an object over to another, in the air."""
