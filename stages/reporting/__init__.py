"""The report: pictures and figures of all results, and the page that shows them."""
