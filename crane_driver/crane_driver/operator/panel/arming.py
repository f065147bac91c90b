"""Who may press the buttons of the page: whoever can read the terminal that the panel runs in."""

import hmac
import secrets

ALPHABET = "abcdefghjkmnpqrstuvwxyz23456789"  # nothing that looks like something else
GROUPS, GROUP_LENGTH = 2, 4
WAIT_S = 1.0  # after a wrong token, for the page that gave it: another page is not held up


def new_token() -> str:
    """Such as `k7mq-2xhd`, at random."""
    groups = ("".join(secrets.choice(ALPHABET) for _ in range(GROUP_LENGTH)) for _ in range(GROUPS))
    return "-".join(groups)


class Arming:
    """Judges what one page gives for the `token`. Times are of the steady clock [s]."""

    def __init__(self, token: str):
        self._token = token.encode()
        self._wait_until = 0.0

    def refusal(self, given: str, now: float) -> str:
        """Why `given` does not arm; empty if it does."""
        if now < self._wait_until:
            return "a wrong token was given a moment ago; wait a second, then try again"
        if hmac.compare_digest(given.strip().lower().encode(errors="replace"), self._token):
            return ""
        self._wait_until = now + WAIT_S
        return "this is not the token that the panel's terminal shows"
