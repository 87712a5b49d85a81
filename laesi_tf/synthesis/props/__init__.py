"""Things that lie on the sheet beside the leaf."""
