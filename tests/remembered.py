"""Work that several tests of a module ask for, done once."""

import hashlib
import pickle


def remembered(work):
    """Do the same work once only: equal arguments are given an equal answer, never the same object."""
    known = {}

    def answer(*asked):
        key = hashlib.sha256(pickle.dumps(asked)).digest()
        if key not in known:
            known[key] = pickle.dumps(work(*asked))
        return pickle.loads(known[key])

    return answer
