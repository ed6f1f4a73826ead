"""Effect of failures and limits: manipulability, attainable sets, worst case."""
