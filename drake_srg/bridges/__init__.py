"""What drives a station from outside, by the messages of the real robot."""
