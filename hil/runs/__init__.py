"""One run in virtual time: what is asked for, what is driven, how it is judged."""
