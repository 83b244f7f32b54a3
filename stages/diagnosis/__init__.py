"""What this machine has, whether the libraries load on it, and what that means for a set of photos."""
