"""Time, memory and size of the report of many views."""
