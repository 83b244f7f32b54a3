"""Relief of a mesh that the photos support, band by band."""
