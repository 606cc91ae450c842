// Reads a tree that mpvi_bt exported with the real BehaviorTree.CPP.
//
//   parse TREE.xml            prints the tree as BehaviorTree.CPP understood it
//   parse TREE.xml --ticks N  ticks it N times, and prints what every leaf did and what the root returned
//   parse TREE.xml --xsd      prints the XML schema that BehaviorTree.CPP writes for its nodes and ours
//
// Nodes of ours are stood in for: they are registered as the file's <TreeNodesModel> describes them. A stub leaf plays
// a script that its first text port holds, such as "door:RRF|S": the name "door", then what it returns tick by tick
// (Running, Success, Failure) in its first round, and after "|" in its next. The last letter and the last round stay.

#include <algorithm>
#include <fstream>
#include <iostream>
#include <regex>
#include <string>
#include <vector>

#include "behaviortree_cpp/bt_factory.h"
#include "behaviortree_cpp/xml_parsing.h"

namespace
{
class StubLeaf : public BT::ActionNodeBase
{
public:
  using BT::ActionNodeBase::ActionNodeBase;

  void halt() override
  {
    if(status() == BT::NodeStatus::RUNNING)
    {
      std::cout << "  " << label() << " halted\n";
    }
    resetStatus();
  }

private:
  BT::NodeStatus tick() override
  {
    const auto rounds = script();
    if(status() != BT::NodeStatus::RUNNING)
    {
      round_++;
      at_ = 0;
    }
    const auto& letters = rounds[std::min(round_, rounds.size()) - 1];
    const char letter = letters[std::min(at_++, letters.size() - 1)];
    std::cout << "  " << label() << " " << letter << "\n";
    return letter == 'S' ? BT::NodeStatus::SUCCESS : letter == 'F' ? BT::NodeStatus::FAILURE : BT::NodeStatus::RUNNING;
  }

  std::string text() const
  {
    for(const auto& [port, written] : config().input_ports)
    {
      const auto held = getInput<std::string>(port);  // of the entry that it refers to
      const auto value = held ? held.value() : written;
      if(value.find(':') != std::string::npos)
      {
        return value;
      }
    }
    return registrationName() + ":S";
  }

  std::string label() const
  {
    return text().substr(0, text().find(':'));
  }

  std::vector<std::string> script() const
  {
    std::vector<std::string> rounds{ "" };
    const auto letters = text().substr(text().find(':') + 1);
    for(const char letter : letters)
    {
      if(letter == '|')
      {
        rounds.emplace_back();
      }
      else
      {
        rounds.back().push_back(letter);
      }
    }
    return rounds;
  }

  size_t round_ = 0;
  size_t at_ = 0;
};

class StubCondition : public BT::ConditionNode
{
public:
  using BT::ConditionNode::ConditionNode;

private:
  BT::NodeStatus tick() override
  {
    return BT::NodeStatus::SUCCESS;
  }
};

class StubDecorator : public BT::DecoratorNode
{
public:
  using BT::DecoratorNode::DecoratorNode;

private:
  BT::NodeStatus tick() override
  {
    throw BT::LogicError("a stub of ", registrationName(), " can be parsed, not ticked");
  }
};

class StubControl : public BT::ControlNode
{
public:
  using BT::ControlNode::ControlNode;

private:
  BT::NodeStatus tick() override
  {
    throw BT::LogicError("a stub of ", registrationName(), " can be parsed, not ticked");
  }
};

template <typename T>
BT::NodeBuilder maker()
{
  return [](const std::string& name, const BT::NodeConfig& config) { return std::make_unique<T>(name, config); };
}

template <typename T>
std::pair<std::string, BT::PortInfo> port(const std::string& name, const std::smatch& found)
{
  auto made = BT::InputPort<T>(name);
  if(found[3].matched)
  {
    made.second.setDefaultValue(found[4].str());
  }
  return made;
}

void registerModels(BT::BehaviorTreeFactory& factory, const std::string& file)
{
  // We write one element a line, so that this does for a parser.
  static const std::regex model(R"re(<(Action|Condition|Decorator|Control) ID="([^"]+)")re");
  static const std::regex input(R"re(<input_port name="([^"]+)" type="([^"]+)"( default="([^"]*)")?)re");
  std::ifstream lines(file);
  std::string line;
  bool inside = false;
  BT::TreeNodeManifest manifest;
  const auto add = [&]() {
    using BT::NodeType;
    switch(manifest.type)
    {
      case NodeType::ACTION:
        return factory.registerBuilder(manifest, maker<StubLeaf>());
      case NodeType::CONDITION:
        return factory.registerBuilder(manifest, maker<StubCondition>());
      case NodeType::DECORATOR:
        return factory.registerBuilder(manifest, maker<StubDecorator>());
      case NodeType::CONTROL:
        return factory.registerBuilder(manifest, maker<StubControl>());
      default:
        return;
    }
  };
  while(std::getline(lines, line))
  {
    std::smatch found;
    inside = inside || line.find("<TreeNodesModel") != std::string::npos;
    if(!inside)
    {
      continue;
    }
    if(std::regex_search(line, found, model))
    {
      add();
      manifest = {};
      manifest.type = BT::convertFromString<BT::NodeType>(found[1].str());
      manifest.registration_ID = found[2];
    }
    else if(std::regex_search(line, found, input))
    {
      const std::string type = found[2];
      manifest.ports.insert(type == "int"    ? port<int>(found[1], found) :
                            type == "double" ? port<double>(found[1], found) :
                            type == "bool"   ? port<bool>(found[1], found) :
                                               port<std::string>(found[1], found));
    }
  }
  add();
}
}  // namespace

int main(int argc, char** argv)
{
  const std::vector<std::string> words(argv + 1, argv + argc);
  if(words.empty())
  {
    std::cerr << "usage: parse TREE.xml [--ticks N | --xsd]\n";
    return 2;
  }
  try
  {
    BT::BehaviorTreeFactory factory;
    registerModels(factory, words[0]);
    if(words.size() > 1 && words[1] == "--xsd")
    {
      std::cout << BT::writeTreeXSD(factory);
      return 0;
    }
    auto tree = factory.createTreeFromFile(words[0]);
    if(words.size() > 2 && words[1] == "--ticks")
    {
      for(int tick = 1; tick <= std::stoi(words[2]); tick++)
      {
        std::cout << "tick " << tick << "\n";
        const auto status = BT::toStr(tree.tickExactlyOnce());
        std::cout << "-> " << status << "\n";
      }
      std::cout << "end\n";  // what still runs is halted when the tree goes
      return 0;
    }
    BT::printTreeRecursively(tree.rootNode(), std::cout);
  }
  catch(const std::exception& error)
  {
    std::cout.flush();
    std::cerr << error.what() << "\n";
    return 1;
  }
  return 0;
}
