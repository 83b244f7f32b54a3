"""The process that runs a stage: child, memory, measurement, logs."""
