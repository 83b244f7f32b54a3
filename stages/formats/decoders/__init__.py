"""Decoders of photos' files: pictures, PNG's chunks, camera raw, HEIF."""
