"""Let external clients command a station with the messages of the real robot."""
