"""The correlations of the physical parameters as a table of the report."""

import numpy as np

from penode.report.sections import parameters
from penode.report.tables import correlation_table


def test_it_has_a_row_and_a_column_a_parameter_and_a_dash_for_what_is_not_known(fit):
    fit.correlation = np.array([[1.0, np.nan], [-0.123, 1.0]])
    table = correlation_table(fit)
    assert table.columns == ("parameter", "mass", "friction")
    texts = [[cell.text for cell in row.cells] for row in table.rows]
    assert texts == [["mass", "1.00", "–"], ["friction", "−0.12", "1.00"]]


def test_the_report_has_it_where_there_are_two_parameters(fit):
    titles = [block.title for block in parameters(fit).blocks[:2]]
    assert titles == ["Physical parameters", "Correlations of the parameters"]
    fit.covariance = fit.covariance[:1, :1]
    assert parameters(fit).blocks[1].title != titles[1]
