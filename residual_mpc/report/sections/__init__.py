"""One section a file, each a function of the document and the evidence."""
