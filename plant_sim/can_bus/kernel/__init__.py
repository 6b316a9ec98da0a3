"""The bus to the bit: arbitration, queues, errors, log; compiled."""
