"""What holds for all tests: processes that they start can be stopped by SIGINT."""

import signal

# A shell has its background jobs ignore SIGINT, and what they start ignores it too until it sets a handler.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
