"""Tables and other text files: read with errors that name file and line, written in one style."""

from .cut import require_whole_end as require_whole_end
from .quantities import QUANTITIES as QUANTITIES
from .quantities import Head as Head
from .quantities import find_quantity as find_quantity
from .quantities import read_head as read_head
from .statements import NUMBER as NUMBER
from .statements import collect_statements as collect_statements
from .statements import find_steps as find_steps
from .statements import find_unit_after as find_unit_after
from .statements import find_units as find_units
from .statements import read_fortran as read_fortran
from .table import Row as Row
from .table import Table as Table
from .table import read_table as read_table
from .text import Statement as Statement
from .text import TextFile as TextFile
from .text import as_number as as_number
from .text import quote_names as quote_names
from .text import quote_word as quote_word
from .text import read_content as read_content
from .units import UNITS_OF_ACCELERATION as UNITS_OF_ACCELERATION
from .units import Unit as Unit
from .units import parse_unit as parse_unit
from .writing import format_heading as format_heading
from .writing import write_csv as write_csv
from .writing import write_inputs as write_inputs
