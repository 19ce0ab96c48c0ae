"""Tables and other text files: read with errors that name file and line, written in one style."""

from .quantities import QUANTITIES as QUANTITIES
from .quantities import UNITS as UNITS
from .quantities import write_label as write_label
from .schema import Column as Column
from .schema import Contents as Contents
from .schema import read_columns as read_columns
from .schema import read_table as read_table
from .table import Head as Head
from .table import Row as Row
from .table import Table as Table
from .table import read_head as read_head
from .text import NamedFile as NamedFile
from .text import TextFile as TextFile
from .text import as_number as as_number
from .text import quote_names as quote_names
from .text import quote_word as quote_word
from .units import UNITS_OF_ACCELERATION as UNITS_OF_ACCELERATION
from .units import Unit as Unit
from .units import parse_unit as parse_unit
from .writing import format_heading as format_heading
from .writing import write_csv as write_csv
from .writing import write_inputs as write_inputs
