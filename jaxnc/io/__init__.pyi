from jaxnc.io.curve_files import Outline as Outline
from jaxnc.io.curve_files import outline as outline
from jaxnc.io.stream import Streamed as Streamed
from jaxnc.io.tables import Table as Table
from jaxnc.io.tables import load_csv as load_csv
from jaxnc.io.tables import load_npz as load_npz
