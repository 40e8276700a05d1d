"""Reading and writing of files, one family of formats each; nothing here knows the nouns."""
