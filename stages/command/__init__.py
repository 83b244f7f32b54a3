"""The command line: its arguments, the requests that follow from them, tables of an evaluation."""
