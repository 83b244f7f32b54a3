"""What compiled loops stand on: eight numbers at a time, sliced sparse rows, threads, memory."""
