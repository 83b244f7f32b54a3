"""The cache: digests, keys, records, the store of results, and their copies in the output."""
