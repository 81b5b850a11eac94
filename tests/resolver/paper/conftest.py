from tests.resolver.likelihood.conftest import search

__all__ = ["search"]
