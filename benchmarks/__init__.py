"""What firnline claims about speed, memory and error, each with the command that measures it."""
