from drake_srg.learning.episodes import EVALUATION as EVALUATION
from drake_srg.learning.episodes import make_environment as make_environment
from drake_srg.learning.episodes import run_episode as run_episode
from drake_srg.learning.episodes import training_seed as training_seed
from drake_srg.learning.policy import Policy as Policy
from drake_srg.learning.policy import load_policy as load_policy
from drake_srg.learning.rules import grasp_one_shot as grasp_one_shot
