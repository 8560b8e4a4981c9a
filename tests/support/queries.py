"""Parses Prometheus' queries, one a line of standard input, and says which is none."""

import sys

import promql_parser

for query in sys.stdin.read().splitlines():
    try:
        promql_parser.parse(query)
    except ValueError as error:
        sys.exit(f"{query}: {error}")
