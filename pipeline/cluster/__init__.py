"""Workers of a Dask cluster: start or join, check, hand out tasks."""
