"""Everything about a real robot: serve a simulation as one, drive one, follow one."""
