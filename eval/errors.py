"""What can go wrong in an evaluation, as exceptions with one base."""


class EvalError(Exception):
    """Base of every error that eval raises on purpose."""


class ScoreError(EvalError, ValueError):
    """Trajectories that cannot be compared, or an unknown option; the message says what is allowed."""


class StudyError(EvalError, ValueError):
    """A study, a cell or its result is not what it should be; the message names it."""
