"""What failures and limits leave: manipulability, attainable sets, the worst case."""
