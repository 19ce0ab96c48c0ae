"""Tables and other text files: read with errors that name file and line, written in one style."""

from .cut import require_whole_end as require_whole_end
from .text import Statement as Statement
from .text import TextFile as TextFile
from .text import as_number as as_number
from .text import quote_names as quote_names
from .text import quote_word as quote_word
from .text import read_content as read_content
