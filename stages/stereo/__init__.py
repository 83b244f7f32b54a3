"""The engines of multi-view stereo: our own, COLMAP's on CUDA, and the sparse points taken as they are."""
