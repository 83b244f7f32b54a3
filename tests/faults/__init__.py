"""Attacks on the command line: death, disks, rot, company, hostile input."""
