"""Extensions of canroll: a law, a body, a manoeuvre and a bus."""
