"""What the report shows beside the diagnosis document, collected from a finished diagnosis."""
