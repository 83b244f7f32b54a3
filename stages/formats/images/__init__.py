"""Readers and writers of photos, masks and float images; photos become linear light here."""
