"""What other people published of robots that we did not choose."""
