"""Figures of merit of a robot's motion: its likeness to the human's, and its violations."""

from hoi_retarget.evaluation.comparison import Comparison as Comparison
from hoi_retarget.evaluation.comparison import Figure as Figure
from hoi_retarget.evaluation.figure_table import COLUMNS as COLUMNS
from hoi_retarget.evaluation.figure_table import Score as Score
from hoi_retarget.evaluation.figure_table import mean_values as mean_values
from hoi_retarget.evaluation.figure_table import table_rows as table_rows
from hoi_retarget.evaluation.figure_table import to_csv as to_csv
from hoi_retarget.evaluation.figure_table import to_json as to_json
from hoi_retarget.evaluation.figure_table import worst_values as worst_values
from hoi_retarget.evaluation.figures import FIGURES as FIGURES
from hoi_retarget.evaluation.figures import SOUNDNESS as SOUNDNESS
from hoi_retarget.evaluation.figures import evaluate as evaluate
from hoi_retarget.evaluation.figures import figures_of as figures_of
from hoi_retarget.evaluation.figures import soundness as soundness
from hoi_retarget.evaluation.multi_robot import inter_robot_hand_errors as inter_robot_hand_errors
from hoi_retarget.evaluation.multi_robot import inter_robot_penetrations as inter_robot_penetrations
from hoi_retarget.evaluation.penetration import sunk_links as sunk_links
from hoi_retarget.evaluation.unreached_contacts import contact_residuals as contact_residuals
from hoi_retarget.evaluation.unreached_contacts import surface_residuals as surface_residuals
from hoi_retarget.evaluation.unreached_contacts import thin_air_contacts as thin_air_contacts
from hoi_retarget.evaluation.unreached_contacts import unreached_contacts as unreached_contacts
