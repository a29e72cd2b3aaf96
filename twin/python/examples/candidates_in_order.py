"""A policy that chooses: it takes the candidates for the second grasp in their order, three at most.

    ftac bench --policy candidates_in_order.py:CandidatesInOrder --combos 10 --trials 1
"""


class CandidatesInOrder:
    """Tries the candidates in their order."""

    def __init__(self, tries=3):
        self.tries = tries

    def choose(self, situation):
        # `holding` has a value for each object: True if it is held. The second object has index 1.
        if situation.phase == "decide" or (not situation.holding[1] and situation.tries < self.tries):
            return situation.tries % len(situation.candidates)
        return None  # keep what is in the hand
