"""What is wrong with a method that somebody named."""


class MethodError(ValueError):
    """A method that cannot be used; ``str()`` of it is one line for the person who named it."""
