from drake_srg.suite.env import SuiteEnv as SuiteEnv
from drake_srg.suite.evaluate import play_episodes as play_episodes
from drake_srg.suite.tasks import EPISODES as EPISODES
from drake_srg.suite.tasks import Task as Task
from drake_srg.suite.tasks import load_tasks as load_tasks
