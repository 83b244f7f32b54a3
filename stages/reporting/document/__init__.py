"""The report as a document: sentences, tables, charts and one HTML page that needs no other file."""
