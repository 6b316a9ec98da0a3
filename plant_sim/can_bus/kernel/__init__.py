"""The bus simulated bit by bit: arbitration, queues, errors, log; compiled."""
